"""Reading and writing files: text to descriptions and back, each file whole or not at all."""
