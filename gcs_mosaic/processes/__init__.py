"""Child processes: how they are started, spoken with, limited, and started again. Imports nothing but the standard library.

`child` is the program's side, `main` what a child does before its own work, `pipe` how they speak with each other, `keeper` when
one is started again; `signals` and `limits` are what holds for all of them. Each user brings its messages and sentences.
"""
