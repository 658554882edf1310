"""What the house may cost as a whole; a room gives before another takes."""

CEILINGS = {
    "lines": 53900,
    "statements": 28050,
    "modules": 398,
    "import depth": 18,
    "lines of tests and tools": 36800,
    "words of documents": 66100,
    "class names with two meanings": 39,
    "variables named by a pronoun": 1345,
}
