"""A MAVLink link: parses bytes into camera events and link reports; transmits only what was explicitly asked for.

May import `even_clock`, `messages` and `errors`; called by `app`.
"""
