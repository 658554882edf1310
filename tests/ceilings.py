"""What the house may cost as a whole; a room gives before another takes."""

CEILINGS = {
    "lines": 26554,
    "statements": 16463,
    "modules": 149,
    "import depth": 12,
    "lines of tests and tools": 22442,
    "words of documents": 29900,
    "class names with two meanings": 0,
    "variables named by a pronoun": 0,
}
