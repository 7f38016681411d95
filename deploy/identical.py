"""Whether runs ended with the same rounds and weights, to the bit: python3 deploy/identical.py FOLDER FOLDER ...

Of each folder the run directory below it whose summary is newest. Times, and what was refused on the way, may differ.
Exit code 1 where one differs from the first, 2 where there are not two.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

_MAY_DIFFER = ("seconds", "refused", "beta")
Ended = tuple[list[dict[str, object]], dict[str, bytes]]


def ended(folder: Path) -> Ended:
    """Rows, and the bytes of each model."""
    run = max(folder.rglob("summary.json"), key=lambda path: path.stat().st_mtime).parent
    rows = [json.loads(line) for line in (run / "rounds.jsonl").read_text().splitlines()]
    kept = [{key: value for key, value in row.items() if key not in _MAY_DIFFER} for row in rows]
    return kept, {path.name: path.read_bytes() for path in sorted((run / "weights").iterdir())}


def main(folders: list[Path]) -> bool:
    first = ended(folders[0])
    same = {folder: ended(folder) == first for folder in folders[1:]}
    for folder, is_same in same.items():
        print(f"{folder}: {len(first[0])} rows, {len(first[1])} models: {'identical' if is_same else 'DIFFERENT'}")
    return all(same.values())


if __name__ == "__main__":
    if len(sys.argv) < 3:
        print("usage: python3 deploy/identical.py FOLDER FOLDER ...", file=sys.stderr)
        sys.exit(2)
    sys.exit(not main([Path(each) for each in sys.argv[1:]]))
