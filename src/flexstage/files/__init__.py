"""Reading and writing files: descriptions as text, atomic writing, cache of results."""
