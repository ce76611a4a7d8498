"""Policies at the other end of a WebSocket: openpi's protocol, a server and a client for it.

Importing this loads neither `websockets` nor `msgpack`; its modules do.
"""
