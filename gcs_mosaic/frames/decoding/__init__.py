"""Decoding in processes of their own, with limits: no picture, damaged or made to harm, costs more than itself.

`decoders` is the door: it hands each picture to a worker process (`process`), whose own side is `worker`. What a picture may
cost is in `limits`, how bytes go to and fro in `channel`, what the C libraries say of a damaged picture in `complaints`.
"""
