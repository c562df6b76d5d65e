"""Repair of `mini`: which scenes the expert shows, training, and what is better and worse then."""
