// Colour maps that are told apart with every kind of sight, by 33 colours each, with straight lines between them.
// viridis: S. van der Walt, N. Smith (CC0). cividis: J. Nunez, C. Anderton, R. Renslow (2018),
// doi:10.1371/journal.pone.0199239.

const MAPS = {
  viridis:
    "440154470d6048186a482374472d7b4537814240863e49893b528b375b8d33638d2f6b8e2c728e297a8e26828e23898e21918c" +
    "1f988b1fa08822a78528ae8032b67a3fbc734ec36b5ec96270cf5784d44b98d83eaddc30c2df23d8e219ece51bfde725",
  cividis:
    "00224e00285b002e6a0533711a386f273e6e32436d3b496c434e6c4b546c535a6d5a5f6e61656f686a716f70737676767d7c78848279" +
    "8c8878938e789b9476a39a74aba072b4a76fbcae6cc4b468cdbb63d5c25edec958e7d150f0d846f9e03afee838",
};

/** (256 x 4) bytes. */
export function colorTable(name) {
  const text = MAPS[name];
  const last = text.length / 6 - 1;
  const table = new Uint8Array(4 * 256).fill(255);
  for (let k = 0; k < 256; k++) {
    const place = (k / 255) * last;
    const first = Math.min(Math.floor(place), last - 1);
    for (let c = 0; c < 3; c++) {
      const [low, high] = [first, first + 1].map((n) => parseInt(text.substr(6 * n + 2 * c, 2), 16));
      table[4 * k + c] = Math.round(low + (place - first) * (high - low));
    }
  }
  return table;
}

/** For CSS: the same from left to right. */
export function gradient(name) {
  const colors = MAPS[name].match(/.{6}/g).map((color) => `#${color}`);
  return `linear-gradient(to right, ${colors.join(", ")})`;
}

/** For kinds: M. Okabe and K. Ito (2002), without black. */
export const KINDS = ["#e69f00", "#56b4e9", "#009e73", "#f0e442", "#cc79a7", "#d55e00", "#0072b2"];
