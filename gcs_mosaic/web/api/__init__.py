"""The JSON API under /api/v1: each module answers one kind of question and has its own `add_routes`.

Handlers check what comes, and leave the work to `views` and `notes` on a thread; none waits for the flight. What is served is
described in `openapi/`, which a test compares with the routes.
"""
