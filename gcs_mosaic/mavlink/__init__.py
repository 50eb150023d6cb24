"""A MAVLink link: bytes become camera events and news of the link, and the little that is said, if that is asked for, is sent.

May import `messages` and `errors`; called by `app`.
"""
