"""The JSON API under /api/v1: each module answers one kind of question.

Handlers check what comes, and leave the work to `views` and `notes` on a thread; none waits for the flight. Beside each stands
what it asks and answers, as dataclasses (`operations`); the description that is served (`openapi`), the checks of what is sent
(`asked`) and the types of the page's scripts (`typescript`) are made of them.
"""
