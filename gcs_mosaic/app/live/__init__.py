"""A live flight: its main loop (`daemon`), its folder, its page, and what the operator asks of it."""
