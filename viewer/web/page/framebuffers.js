// Where a picture is drawn before it is shown: each room is as large as the canvas.

const SMOOTH = 4; // samples a pixel of what is kept

// The kept picture, one at work, the places of the skin, these without depths, and one with smooth edges.
export function openRooms(pieces, width, height) {
  const { gl } = pieces, plain = [gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE];
  const plane = (sampler, ...kind) => pieces.texture(sampler, ...kind, width, height);
  const depth = plane("depths", gl.DEPTH_COMPONENT24, gl.DEPTH_COMPONENT, gl.UNSIGNED_INT);
  const places = plane("places", gl.RGBA32UI, gl.RGBA_INTEGER, gl.UNSIGNED_INT);
  return {
    kept: room(gl, plane("kept", ...plain), depth),
    work: room(gl, plane("kept", ...plain), depth),
    places: room(gl, places, depth),
    bare: room(gl, places, null), // where the depths can be read meanwhile
    smooth: smoothRoom(gl, width, height),
  };
}

export function closeRooms(gl, rooms) {
  for (const { frame, textures, stores } of Object.values(rooms || {})) {
    gl.deleteFramebuffer(frame);
    textures.forEach((one) => gl.deleteTexture(one));
    stores.forEach((one) => gl.deleteRenderbuffer(one));
  }
}

function room(gl, shown, depth) {
  const frame = gl.createFramebuffer();
  gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, shown, 0);
  if (depth) gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, depth, 0);
  return { frame, shown, textures: depth ? [shown, depth] : [shown], stores: [] };
}

function smoothRoom(gl, width, height) {
  const frame = gl.createFramebuffer(), samples = Math.min(SMOOTH, gl.getParameter(gl.MAX_SAMPLES));
  gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
  const stores = [[gl.COLOR_ATTACHMENT0, gl.RGBA8], [gl.DEPTH_ATTACHMENT, gl.DEPTH_COMPONENT24]].map(([where, format]) => {
    const made = gl.createRenderbuffer();
    gl.bindRenderbuffer(gl.RENDERBUFFER, made);
    gl.renderbufferStorageMultisample(gl.RENDERBUFFER, samples, format, width, height);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, where, gl.RENDERBUFFER, made);
    return made;
  });
  return { frame, textures: [], stores };
}
