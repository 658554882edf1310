"""What the house may cost as a whole; a room gives before another takes."""

CEILINGS = {
    "lines": 25796,
    "statements": 14911,
    "modules": 130,
    "import depth": 12,
    "lines of tests and tools": 21926,
    "words of documents": 29900,
    "class names with two meanings": 0,
    "variables named by a pronoun": 0,
}
