// WebGL2 in a few functions: programs, textures, and drawing a rectangle with them.

const CORNERS = `#version 300 es
void main() { gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0); }`;

/** A context, or null where the browser has none. */
export function openGl(canvas) {
  return canvas.getContext("webgl2", { alpha: true, antialias: false, depth: false, premultipliedAlpha: true });
}

function shader(gl, kind, source) {
  const made = gl.createShader(kind);
  gl.shaderSource(made, source);
  gl.compileShader(made);
  if (!gl.getShaderParameter(made, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(made));
  return made;
}

/** The program of a fragment shader of the page, and where its uniforms are. */
export function program(gl, name) {
  const text = (id) => document.getElementById(id).textContent;
  const made = gl.createProgram();
  gl.attachShader(made, shader(gl, gl.VERTEX_SHADER, CORNERS));
  gl.attachShader(made, shader(gl, gl.FRAGMENT_SHADER, text("common").trimStart() + text(name)));
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
  const block = gl.getUniformBlockIndex(made, "Taps");
  if (block !== gl.INVALID_INDEX) gl.uniformBlockBinding(made, block, 0);
  const at = {};
  for (let k = 0; k < gl.getProgramParameter(made, gl.ACTIVE_UNIFORMS); k++) {
    const { name: uniform, type } = gl.getActiveUniform(made, k);
    const place = gl.getUniformLocation(made, uniform);
    if (place !== null) at[uniform] = { place, type }; // those of the block have none
  }
  return { made, at };
}

/** Draw with a program. Textures are given as {kind, texture}; uniforms that a program leaves out do not count. */
export function draw(gl, { made, at }, values, target = null) {
  gl.bindFramebuffer(gl.FRAMEBUFFER, target ? target.frame : null);
  const [x, y, width, height] = values.viewport;
  gl.viewport(x, y, width, height);
  gl.useProgram(made);
  let unit = 0;
  for (const [name, { place, type }] of Object.entries(at)) {
    const value = values[name];
    if (type === gl.SAMPLER_2D || type === gl.SAMPLER_2D_ARRAY) {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(type === gl.SAMPLER_2D ? gl.TEXTURE_2D : gl.TEXTURE_2D_ARRAY, value);
      gl.uniform1i(place, unit++);
    } else if (type === gl.INT) gl.uniform1i(place, value);
    else if (type === gl.FLOAT) gl.uniform1f(place, value);
    else if (type === gl.FLOAT_VEC2) gl.uniform2fv(place, value);
    else if (type === gl.FLOAT_VEC3) gl.uniform3fv(place, value);
    else gl.uniform4fv(place, value);
  }
  gl.drawArrays(gl.TRIANGLES, 0, 3);
}

/** A function that says what programs do with views: four numbers each, for at most 256. */
export function tapsOf(gl) {
  const buffer = gl.createBuffer();
  const numbers = new Float32Array(4 * 256);
  gl.bindBufferBase(gl.UNIFORM_BUFFER, 0, buffer);
  return (taps) => {
    numbers.set(taps);
    gl.bindBuffer(gl.UNIFORM_BUFFER, buffer);
    gl.bufferData(gl.UNIFORM_BUFFER, numbers, gl.DYNAMIC_DRAW);
    return taps.length / 4;
  };
}

/** A texture of numbers that are read one by one; from an array, so many numbers a pixel (1 or 4). */
export function numbersTexture(gl, values, width, height) {
  const each = values.length / (width * height);
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, texture);
  const [inside, format, type] =
    values instanceof Uint8Array ? [gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE]
    : each === 1 ? [gl.R32F, gl.RED, gl.FLOAT]
    : [gl.RGBA32F, gl.RGBA, gl.FLOAT];
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  gl.texImage2D(gl.TEXTURE_2D, 0, inside, width, height, 0, format, type, values);
  still(gl, gl.TEXTURE_2D, gl.NEAREST);
  return texture;
}

/** No mipmaps, no repetition. */
export function still(gl, kind, filter) {
  gl.texParameteri(kind, gl.TEXTURE_MIN_FILTER, filter);
  gl.texParameteri(kind, gl.TEXTURE_MAG_FILTER, filter);
  gl.texParameteri(kind, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
  gl.texParameteri(kind, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
}

/** A picture to draw into: of 16-bit floats, or, where cards cannot, 8-bit sRGB, which is decoded where it is read. */
export function target(gl, width, height, exact = false) {
  const floats = gl.getExtension("EXT_color_buffer_float") !== null;
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, texture);
  gl.texStorage2D(gl.TEXTURE_2D, 1, floats ? (exact ? gl.RGBA32F : gl.RGBA16F) : gl.SRGB8_ALPHA8, width, height);
  still(gl, gl.TEXTURE_2D, exact ? gl.NEAREST : gl.LINEAR);
  const frame = gl.createFramebuffer();
  gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
  return { texture, frame, floats };
}

/** The numbers of a row of a target, when the card is done: asking at once would make everything wait. */
export async function rowOf(gl, from, count) {
  const buffer = gl.createBuffer();
  gl.bindFramebuffer(gl.FRAMEBUFFER, from.frame);
  gl.bindBuffer(gl.PIXEL_PACK_BUFFER, buffer);
  gl.bufferData(gl.PIXEL_PACK_BUFFER, 16 * count, gl.STREAM_READ);
  gl.readPixels(0, 0, count, 1, gl.RGBA, gl.FLOAT, 0);
  gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
  const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
  gl.flush();
  while (gl.clientWaitSync(fence, 0, 0) === gl.TIMEOUT_EXPIRED) await new Promise((done) => setTimeout(done, 10));
  gl.deleteSync(fence);
  const row = new Float32Array(4 * count);
  gl.bindBuffer(gl.PIXEL_PACK_BUFFER, buffer);
  gl.getBufferSubData(gl.PIXEL_PACK_BUFFER, 0, row);
  gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
  gl.deleteBuffer(buffer);
  return row;
}
