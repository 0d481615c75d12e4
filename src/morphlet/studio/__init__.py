"""The interactive window in the browser: a session, the protocol that it speaks, and the server that speaks it."""
