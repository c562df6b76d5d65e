"""Logs of evaluations that others ran: formats in, episodes as values, figures, a comparison of two."""
