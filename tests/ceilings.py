"""What the house may cost as a whole; a room gives before another takes."""

CEILINGS = {
    "lines": 39605,
    "statements": 20768,
    "modules": 222,
    "import depth": 14,
    "lines of tests and tools": 31960,
    "words of documents": 30000,
    "class names with two meanings": 0,
    "variables named by a pronoun": 402,
}
