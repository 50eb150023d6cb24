"""What a flight hands over: a mission over its gaps or an outlined area, one file for the debriefing, a find in a message.

All of it is advice to people and is made of the finished map: nothing here is sent to an aircraft.

May import `detection`, `geo`, `notes`, `integral`, `views`, `store`, `render`, `stitch.arrays`, `messages` and
`errors`; called by `export` and `web`.
"""
