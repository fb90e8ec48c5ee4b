// Programs of the picture. Lengths are metres; lighting is a lamp at the camera.

import { COLOURS } from "./colour_map.js";

// The texture unit of each sampler, the same in all programs.
export const UNITS = { table: 0, values: 1, codes: 2, faces: 3, kept: 4, places: 5, depths: 6 };

// Where the place of a list is in its texture.
const LIST = "ivec2 at(int k) { return ivec2(k & 2047, k >> 11); }";

const SHADE = "float shade(float facing) { return min(1.0, 0.5 + 0.52 * max(facing, 0.0)); }";

export const BODY = {
  vertex: `
in vec3 position; in vec4 normal;
uniform mat4 seen, model; uniform mat4 camera;
out float facing;
void main() {
  gl_Position = seen * vec4(position, 1.0);
  facing = normalize(mat3(camera) * mat3(model) * normal.xyz).z;
}`,
  fragment: `
in float facing; out vec4 pixel;
uniform vec3 colour;
void main() {
  float f = max(facing, 0.0);
  pixel = vec4(colour * (0.25 + 0.75 * f) + 0.06 * pow(f, 24.0), 1.0);
}`,
};

// Shells have no normals: each facet is lit by how its own plane lies.
export const SHELL = {
  vertex: `
in vec3 position;
uniform mat4 seen, model, camera;
out vec3 place;
void main() {
  gl_Position = seen * vec4(position, 1.0);
  place = (camera * model * vec4(position, 1.0)).xyz;
}`,
  fragment: `
in vec3 place; out vec4 pixel;
uniform vec3 colour;
void main() {
  vec3 n = normalize(cross(dFdx(place), dFdy(place)));
  pixel = vec4(colour * (0.3 + 0.7 * abs(n.z)), 1.0);
}`,
};

// A sheet carries a value from 0 to 254 to each vertex, and how far it is known.
export const SHEET = {
  vertex: `
in vec3 position; in vec4 normal;
uniform mat4 seen, model, camera; uniform sampler2D values;
out float facing; out vec2 shown;
${LIST}
void main() {
  gl_Position = seen * vec4(position, 1.0);
  facing = normalize(mat3(camera) * mat3(model) * normal.xyz).z;
  shown = texelFetch(values, at(gl_VertexID), 0).xy;
}`,
  fragment: `
in float facing; in vec2 shown; out vec4 pixel;
${SHADE}
${COLOURS}
void main() { pixel = vec4(sheetColour(shown) * shade(facing), 1.0); }`,
};

// Hexagons lying in the skin: an arm of length 1 leads from the centre to each corner.
export const DISC = {
  vertex: `
in vec3 centre, arm; in vec4 axis; in float number;
uniform mat4 seen, model, camera; uniform float radius, lift; uniform usampler2D codes;
out float facing; flat out int taxel; flat out float row;
${LIST}
void main() {
  vec3 n = normalize(axis.xyz);
  vec3 p = centre + lift * n + radius * arm;
  gl_Position = seen * vec4(p, 1.0);
  facing = normalize(mat3(camera) * mat3(model) * n).z;
  taxel = int(number);
  row = float(texelFetch(codes, at(taxel), 0).x);
}`,
  fragment: `
in float facing; flat in int taxel; flat in float row; out vec4 pixel;
uniform vec3 plain; uniform float mode; // 0 by value, 1 in one colour, 2 by number, for picking
${SHADE}
${COLOURS}
void main() {
  int k = taxel + 1;
  vec3 c = mode > 0.5 ? plain : taxelColour(row) * shade(facing);
  pixel = mode > 1.5 ? vec4(k & 255, (k >> 8) & 255, k >> 16, 255) / 255.0 : vec4(c, 1.0);
}`,
};

// Which point of the skin each pixel shows, while camera and robot rest: a face of the sheet with the
// shares of its corners, or a taxel; 0 where something else is seen.
export const PLACES = {
  vertex: `
in vec3 position; in vec4 normal; in vec3 centre, arm; in vec4 axis; in float number;
uniform mat4 seen, model, camera; uniform float radius, discs;
out float facing; out vec2 share; flat out uint what;
void main() {
  bool disc = discs > 0.5;
  vec3 n = normalize(disc ? axis.xyz : normal.xyz);
  gl_Position = seen * vec4(disc ? centre + radius * arm : position, 1.0);
  facing = normalize(mat3(camera) * mat3(model) * n).z;
  int corner = gl_VertexID % 3;
  share = vec2(corner == 0, corner == 1);
  what = disc ? uint(number) | 0x80000000u : uint(gl_VertexID / 3 + 1);
}`,
  fragment: `
in float facing; in vec2 share; flat in uint what; out uvec4 place;
${SHADE}
void main() {
  uvec2 s = uvec2(clamp(share, 0.0, 1.0) * 4095.0 + 0.5);
  uint about = s.x | s.y << 12 | uint(shade(facing) * 255.0 + 0.5) << 24;
  place = uvec4(what, about, floatBitsToUint(gl_FragCoord.z), 0u);
}`,
};

const ALL = `
void main() { // one triangle that covers all
  gl_Position = vec4(vec2(gl_VertexID == 1 ? 3 : -1, gl_VertexID == 2 ? 3 : -1), 0.0, 1.0);
}`;

// Depths of the kept picture, where no skin is.
export const DEPTH = {
  vertex: ALL,
  fragment: `
out uvec4 place;
uniform sampler2D depths;
void main() {
  place = uvec4(0u, 0u, floatBitsToUint(texelFetch(depths, ivec2(gl_FragCoord.xy), 0).r), 0u);
}`,
};

// The picture as it was kept, with new values where it shows skin.
export const SHOW = {
  vertex: ALL,
  fragment: `
out vec4 pixel;
uniform sampler2D kept, values; uniform usampler2D places, faces, codes; uniform float live;
${LIST}
${COLOURS}
void main() {
  ivec2 here = ivec2(gl_FragCoord.xy);
  uvec2 place = live > 0.5 ? texelFetch(places, here, 0).xy : uvec2(0);
  if (place.x == 0u) {
    pixel = vec4(texelFetch(kept, here, 0).rgb, 1.0);
    return;
  }
  vec3 c;
  if (place.x >= 0x80000000u) c = taxelColour(float(texelFetch(codes, at(int(place.x & 0x7fffffffu)), 0).x));
  else {
    uvec3 v = texelFetch(faces, at(int(place.x) - 1), 0).xyz;
    vec2 s = vec2(place.y & 4095u, (place.y >> 12) & 4095u) / 4095.0;
    c = sheetColour(s.x * texelFetch(values, at(int(v.x)), 0).xy + s.y * texelFetch(values, at(int(v.y)), 0).xy
      + (1.0 - s.x - s.y) * texelFetch(values, at(int(v.z)), 0).xy);
  }
  pixel = vec4(c * float(place.y >> 24) / 255.0, 1.0);
}`,
};

// Lines of a width in pixels: each segment is two triangles, lifted a little towards the camera.
export const LINE = {
  vertex: `
in vec2 corner; in vec3 from, to; in vec3 tint;
uniform mat4 seen; uniform vec2 pixels; uniform float width, nearer;
out vec3 c;
void main() {
  vec4 a = seen * vec4(from, 1.0), b = seen * vec4(to, 1.0);
  vec2 along = (b.xy / b.w - a.xy / a.w) * pixels;
  float l = length(along);
  vec2 d = l > 1e-6 ? along / l : vec2(1.0, 0.0);
  vec4 p = corner.x < 0.5 ? a : b;
  vec2 shift = (corner.x - 0.5) * d + corner.y * vec2(-d.y, d.x);
  gl_Position = vec4(p.xy + shift * width / pixels * p.w, p.z - nearer * p.w, p.w);
  c = tint;
}`,
  fragment: `
in vec3 c; out vec4 pixel;
uniform vec4 halo; uniform sampler2D depths; uniform float tested;
void main() {
  if (tested > 0.5 && gl_FragCoord.z > texelFetch(depths, ivec2(gl_FragCoord.xy), 0).r) discard;
  pixel = vec4(mix(c, halo.rgb, halo.a), 1.0);
}`,
};

const PRECISION = ["float", "int", "sampler2D", "usampler2D"].map((kind) => `precision highp ${kind};`).join("\n");

export function program(gl, source) {
  const made = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, source.vertex], [gl.FRAGMENT_SHADER, source.fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, `#version 300 es\n${PRECISION}\n${text}`);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
  const at = {};
  for (let i = 0; i < gl.getProgramParameter(made, gl.ACTIVE_UNIFORMS); i++) {
    const { name } = gl.getActiveUniform(made, i);
    at[name] = gl.getUniformLocation(made, name);
  }
  gl.useProgram(made);
  for (const [name, place] of Object.entries(UNITS)) if (name in at) gl.uniform1i(at[name], place);
  return { made, at, attribute: (name) => gl.getAttribLocation(made, name) };
}
