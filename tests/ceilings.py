"""What the house may cost as a whole; a room gives before another takes."""

CEILINGS = {
    "lines": 35929,
    "statements": 19459,
    "modules": 197,
    "import depth": 12,
    "lines of tests and tools": 29671,
    "words of documents": 30000,
    "class names with two meanings": 0,
    "variables named by a pronoun": 0,
}
