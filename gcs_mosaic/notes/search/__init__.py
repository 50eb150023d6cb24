"""How people search: what was looked at, the hints they have dismissed, and those they wish for."""
