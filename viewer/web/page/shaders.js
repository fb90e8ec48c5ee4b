// Programs of the picture. Lengths are metres; lighting is a lamp at the camera.

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
in vec3 position; in vec4 normal; in vec2 value;
uniform mat4 seen, model, camera;
out float facing; out vec2 shown;
void main() {
  gl_Position = seen * vec4(position, 1.0);
  facing = normalize(mat3(camera) * mat3(model) * normal.xyz).z;
  shown = value;
}`,
  fragment: `
in float facing; in vec2 shown; out vec4 pixel;
uniform sampler2D table; uniform float size; uniform vec3 unknown; uniform float lit;
void main() {
  float row = clamp(shown.x / max(shown.y, 1e-3), 0.0, size - 1.0);
  vec3 c = shown.y < 0.5 ? unknown : texture(table, vec2((row + 0.5) / size, 0.5)).rgb;
  pixel = vec4(c * mix(1.0, min(1.0, 0.5 + 0.52 * max(facing, 0.0)), lit), 1.0);
}`,
};

// Hexagons lying in the skin: an arm of length 1 leads from the centre to each corner.
export const DISC = {
  vertex: `
in vec3 centre, arm; in vec4 axis; in float code;
uniform mat4 seen, model, camera; uniform float radius, lift;
out float facing; flat out float row;
void main() {
  vec3 n = normalize(axis.xyz);
  vec3 p = centre + lift * n + radius * arm;
  gl_Position = seen * vec4(p, 1.0);
  facing = normalize(mat3(camera) * mat3(model) * n).z;
  row = code;
}`,
  fragment: `
in float facing; flat in float row; out vec4 pixel;
uniform sampler2D table; uniform float size; uniform vec3 unknown; uniform vec3 plain;
uniform float mode; // 0 by value, 1 in one colour, 2 by number, for picking
void main() {
  if (mode > 1.5) {
    float k = row + 1.0;
    pixel = vec4(mod(k, 256.0), mod(floor(k / 256.0), 256.0), floor(k / 65536.0), 255.0) / 255.0;
    return;
  }
  vec3 c = row > 254.5 ? unknown : texture(table, vec2((row + 0.5) / size, 0.5)).rgb;
  c *= min(1.0, 0.5 + 0.52 * max(facing, 0.0));
  pixel = vec4(mode > 0.5 ? plain : c, 1.0);
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
uniform vec4 halo;
void main() { pixel = vec4(mix(c, halo.rgb, halo.a), 1.0); }`,
};

export function program(gl, source) {
  const made = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, source.vertex], [gl.FRAGMENT_SHADER, source.fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, `#version 300 es\nprecision highp float;\n${text}`);
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
  return { made, at, attribute: (name) => gl.getAttribLocation(made, name) };
}
