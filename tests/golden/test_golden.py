"""No bit changes that is not meant to: images, ground truth and rays are those that are stored in golden.json.

Where a change of bits is meant, ``python tests/golden --write`` stores the new ones, and the commit says why.
"""

import pytest
from golden_hashes import CASES, QUICK, hashes, stored

EXPECTED = stored()
UNKNOWN = (
    "bits are promised on one machine; write them with `python tests/golden --write` before a change and run the tests "
    "after it"
)


@pytest.mark.skipif(EXPECTED is None, reason=UNKNOWN)
@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in CASES]
)
def test_the_same_bits(name):
    expected, found = EXPECTED.get(name, {}), hashes(CASES[name])
    different = sorted(array for array in expected | found if expected.get(array) != found.get(array))
    assert not different, f"{name}: other bits in {', '.join(different)}"
