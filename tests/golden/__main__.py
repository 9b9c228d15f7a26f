"""Print the hashes of all golden cases: ``python tests/golden [--write] [--only white,objects]``."""

import argparse
import time

from golden_hashes import CASES, hashes, key, store, stored


def main():
    parser = argparse.ArgumentParser(prog="python tests/golden", description="Print the hashes of all golden cases.")
    parser.add_argument("--write", action="store_true", help="store them as what the tests expect")
    parser.add_argument("--only", default=",".join(CASES), help="some of the cases, joined by commas")
    options = parser.parse_args()
    chosen = options.only.split(",")
    unknown = sorted(set(chosen) - set(CASES))
    if unknown:
        parser.error(f"--only has {', '.join(unknown)}; it may have {', '.join(CASES)}")
    print(key(), flush=True)
    found = {}
    for name in chosen:
        begin = time.process_time()
        found[name] = hashes(CASES[name])
        print(f"\n{name}, {time.process_time() - begin:.1f} s of CPU")
        print(*(f"  {digest}  {array}" for array, digest in found[name].items()), sep="\n", flush=True)
    if options.write:
        kept = {name: known for name, known in (stored() or {}).items() if name in CASES}
        store(kept | found)


if __name__ == "__main__":
    main()
