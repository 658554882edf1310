"""Print the README's set-up commands, one a line: what stands in the first code block of its section "Set up"."""

import sys
from pathlib import Path

SECTION = "## Set up"


def setup_commands(text: str) -> list[str]:
    """The commands of the section's first fenced block, without comments and blank lines."""
    _, found, section = text.partition(f"\n{SECTION}\n")
    if not found:
        raise SystemExit(f"the README has no section '{SECTION}'")
    block = section.split("\n## ")[0].split("```")[1]
    lines = block.splitlines()[1:]
    return [line.strip() for line in lines if line.strip() and not line.lstrip().startswith("#")]


if __name__ == "__main__":
    print(
        "\n".join(setup_commands(Path(sys.argv[1] if len(sys.argv) > 1 else "README.md").read_text(encoding="utf-8")))
    )
