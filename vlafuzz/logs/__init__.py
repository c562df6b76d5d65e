"""Logs of evaluations that others ran: formats in, episodes as values and figures."""
