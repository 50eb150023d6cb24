"""The file of notes, its tables, and the check of what people have typed into it."""
