"""One module per arm; each defines `ARM`. A new file here is a new arm, nothing else has to change."""
