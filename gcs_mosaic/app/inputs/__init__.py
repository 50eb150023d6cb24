"""What comes in: links, frames of every kind of source, and the outcome of every camera event."""
