// Both pictures of one sample, the card's and the one that scripts draw, and the flat map: random
// bytes, so that smoothing carries values beyond both ends of the table, and some unknown.
(seed) => {
  clearTimeout(skinmap.still);
  const { picture, camera, smoother, flat } = skinmap, { canvas, rest, gl } = picture, { width, height } = canvas;
  const codes = new Uint8Array(picture.codes.length);
  for (let k = 0, x = seed; k < codes.length; k++) {
    x = (1664525 * x + 1013904223) >>> 0;
    codes[k] = [0, 254, x >>> 24, 255][(x >>> 16) % 10 < 7 ? (x >>> 8) & 1 : (x >>> 16) % 10 === 9 ? 3 : 2];
  }
  const values = smoother.carry(codes).slice(), beyond = values.filter((x, k) => !(k % 2) && (x < -3 || x > 257)).length;
  picture.touches.set([]); picture.signs.set([]); picture.chosen.set([]);
  picture.keep(camera, true);
  picture.setValues(codes, values);
  const bytes = (act) => { act(); const b = new Uint8Array(4 * width * height); gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, b); return b; };
  picture.software = true;
  picture.draw(camera, true, false);
  const script = rest.canvas.getContext("2d").getImageData(0, 0, width, height).data;
  picture.software = false;
  picture.keptSmooth = true; // only the way of drawing samples is to differ
  const card = bytes(() => { picture.draw(camera, true, false); gl.bindFramebuffer(gl.FRAMEBUFFER, null); });
  picture.software = true;
  flat.setValues(codes, values); flat.setRings([]); flat.setSigns([]); flat.setLines([]); flat.stale = true; flat.draw(1);
  const map = flat.paper.getImageData(0, 0, flat.canvas.width, flat.canvas.height).data;
  let worst = 0, apart = 0, black = 0, skin = 0;
  for (let y = 0; y < height; y++) for (let x = 0; x < width; x++) {
    const a = 4 * (y * width + x), b = 4 * ((height - 1 - y) * width + x);
    const gap = Math.max(...[0, 1, 2].map((i) => Math.abs(script[a + i] - card[b + i])));
    worst = Math.max(worst, gap); apart += gap > 1;
    black += Math.max(script[a], script[a + 1], script[a + 2]) < 12;
  }
  for (let k = 0; k < map.length; k += 4) black += Math.max(map[k], map[k + 1], map[k + 2]) < 12;
  return { beyond, worst, apart, black, skin: rest.pixels.length };
}
