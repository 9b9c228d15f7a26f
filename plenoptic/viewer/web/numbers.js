// Numbers as people read them.

const PREFIXES = [[1e6, "km"], [1e4, "m"], [0, "mm"]];

/** With so many significant digits, without an exponent where it can be read without. */
export function significant(value, digits = 4) {
  if (Number.isNaN(value)) return "–";
  if (!Number.isFinite(value)) return value > 0 ? "∞" : "−∞";
  const size = Math.abs(value);
  if (size !== 0 && (size < 1e-4 || size >= 1e7)) return value.toExponential(digits - 1).replace("-", "−");
  const places = size === 0 ? 0 : Math.max(0, digits - 1 - Math.floor(Math.log10(size)));
  return value.toFixed(Math.min(places, 8)).replace("-", "−");
}

/** A length in mm, in the unit that suits it. */
export function length(mm, digits = 5) {
  if (!Number.isFinite(mm)) return significant(mm);
  const [size, unit] = PREFIXES.find(([least]) => Math.abs(mm) >= least);
  return `${significant(unit === "mm" ? mm : unit === "m" ? mm / 1e3 : mm / 1e6, digits)} ${unit}`;
}

/** A value with its standard error, to the digits that the error leaves. */
export function withError(value, error, digits = 4) {
  if (!Number.isFinite(error) || !Number.isFinite(value)) return significant(value, digits);
  const enough = error > 0 && value !== 0 ? Math.ceil(Math.log10(Math.abs(value) / error)) + 2 : digits;
  return `${significant(value, Math.min(Math.max(enough, 2), 6))} ± ${significant(error, 2)}`;
}

/** Round numbers, at most so many, within a range. */
export function ticks(low, high, most = 5) {
  const rough = (high - low) / most;
  if (!(rough > 0)) return [low];
  const ten = 10 ** Math.floor(Math.log10(rough));
  const step = ten * [1, 2, 5, 10].find((part) => part * ten >= rough);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(k * step);
  return found;
}

/** The value below which a share of the finite ones lies; NaN where there is none. */
export function percentile(values, share) {
  const step = Math.max(1, Math.floor(values.length / 65536));
  const known = [];
  for (let k = 0; k < values.length; k += step) if (Number.isFinite(values[k])) known.push(values[k]);
  known.sort((a, b) => a - b);
  return known.length ? known[Math.min(known.length - 1, Math.floor(share * known.length))] : NaN;
}

export const clamp = (value, low, high) => Math.min(Math.max(value, low), high);
