"""What a run over a recording came to: on the terminal, and as the JSON of `--summary`."""

import json
from pathlib import Path

from followerd.errors import UsageError


def print_result(result: dict[str, object]) -> None:
    """One figure a line; those in groups with the group's name before them."""
    for name, value in result.items():
        parts = value if isinstance(value, dict) else {"": value}
        for part, number in parts.items():
            text = f"{number:.3f}" if isinstance(number, float) else str(number)
            print(f"{name}{'.' if part else ''}{part}: {text}")


def write_result(path: Path, result: dict[str, object]) -> None:
    """Write the JSON file; raises UsageError."""
    try:
        path.write_text(json.dumps(result, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    except OSError as error:
        raise UsageError(f"--summary {path}: cannot be written: {error.strerror}") from error
