"""What the commands leave in a results folder: JSON documents, and the history of models."""
