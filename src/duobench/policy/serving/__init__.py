"""Policies at the other end of a WebSocket: a server and clients, in the protocols of the field."""
