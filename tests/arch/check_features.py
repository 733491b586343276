"""Holds docs/features.md to its word: every row of the floor is there, and every test that it names exists.

A test is `Suite.Name` of a GoogleTest source under tests/, or `tests/studio/NAME.py`.

usage: check_features.py ROOT
"""
import pathlib
import re
import sys

# Rows of the feature table that users of such programs expect.
FLOOR = [*range(1, 14), 16, 17, 19, 20, 21, 22, *range(26, 32), 33, 35, 36, 37, 40, 41, 43, 45]
ROW = re.compile(r"^\|\s*(\d+)\s*\|(.*)\|(.*)\|(.*)\|\s*$")
TEST = re.compile(r"^\s*(?:TEST|TEST_F|TEST_P|TYPED_TEST)\(\s*(\w+)\s*,\s*(\w+)\s*\)", re.M)


def main(root):
    root = pathlib.Path(root)
    known = set()
    for source in (root / "tests").rglob("*.cpp"):
        known |= {f"{suite}.{name}" for suite, name in TEST.findall(source.read_text(encoding="utf-8"))}
    problems, rows = [], {}
    for line in (root / "docs/features.md").read_text(encoding="utf-8").splitlines():
        match = ROW.match(line)
        if match:
            rows[int(match[1])] = re.findall(r"`([^`]+)`", match[4])
    for number in FLOOR:
        if number not in rows:
            problems.append(f"row {number} is missing")
    for number, tests in rows.items():
        if not tests:
            problems.append(f"row {number} names no test")
        for test in tests:
            if test.startswith("tests/"):
                if not (root / test).is_file():
                    problems.append(f"row {number}: no file {test}")
            elif test not in known:
                problems.append(f"row {number}: no test {test}")
    for problem in problems:
        print(f"docs/features.md: {problem}", file=sys.stderr)
    return 1 if problems else 0


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    sys.exit(main(sys.argv[1]))
