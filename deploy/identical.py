"""Whether runs ended with the same rounds and weights, to the bit: python3 deploy/identical.py FOLDER FOLDER ...

Of each folder the newest run directory below it that has a summary. Times, and what was refused on the way, may differ.
Exit code 1 where one differs from the first.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

_MAY_DIFFER = ("seconds", "refused", "beta")
Ended = tuple[list[dict[str, object]], dict[str, bytes]]


def ended(folder: Path) -> Ended:
    """Rows, and the bytes of each model."""
    run = max(path.parent for path in folder.rglob("summary.json"))
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
    sys.exit(not main([Path(each) for each in sys.argv[1:]]))
