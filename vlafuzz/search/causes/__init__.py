"""Search for causes: failures are attributed as they come; then it looks where none is explained."""
