"""One command a file; each defines ``command`` and keeps heavy imports inside its function."""
