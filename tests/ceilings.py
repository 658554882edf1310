"""What the house may cost as a whole; a room gives before another takes."""

CEILINGS = {
    "lines": 32000,
    "statements": 18500,
    "modules": 190,
    "import depth": 12,
    "lines of tests and tools": 28000,
    "words of documents": 30000,
    "class names with two meanings": 0,
    "variables named by a pronoun": 0,
}
