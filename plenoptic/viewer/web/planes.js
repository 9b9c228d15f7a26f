// What the page holds: one block of bytes in base64, and facts that say what lies where. See blocks.py.

const NOTHING = 65535, INFINITE = 65534;
const RECIPROCAL = 1, ASINH = 2;

export function readFacts() {
  return JSON.parse(document.getElementById("facts").textContent);
}

/** All bytes of the page; the text is given back to the browser. */
export function readBytes() {
  const element = document.getElementById("data");
  const text = element.textContent.trim();
  element.remove();
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let k = 0; k < binary.length; k++) bytes[k] = binary.charCodeAt(k);
  return bytes;
}

export const part = (bytes, [start, size]) => bytes.subarray(start, start + size);

async function inflated(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** Whole numbers, row by row. */
export async function wholeNumbers(bytes, block, columns) {
  const split = await inflated(part(bytes, block.bytes));
  const size = block.wide ? 4 : 2;
  const count = split.length / size;
  const codes = block.wide ? new Uint32Array(count) : new Uint16Array(count);
  for (let k = 0; k < size; k++)
    for (let n = 0; n < count; n++) codes[n] |= split[k * count + n] << (8 * k);
  // They were differences along rows, modulo the largest number.
  for (let n = 0; n < count; n++) if (n % columns) codes[n] += codes[n - 1];
  return codes;
}

/** Values, row by row; NaN where there is none. */
export async function plane(bytes, block, columns) {
  const codes = await wholeNumbers(bytes, block, columns);
  const values = new Float32Array(codes.length);
  const curve = block.curve;
  for (let n = 0; n < codes.length; n++) {
    const code = codes[n];
    const bent = block.low + block.step * code;
    values[n] =
      code === NOTHING ? NaN
      : code === INFINITE ? Infinity
      : curve === RECIPROCAL ? 1 / bent
      : curve === ASINH ? block.unit * Math.sinh(bent)
      : bent;
  }
  return values;
}
