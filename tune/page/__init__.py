"""A page for one folder in a browser: its logs, device, scene and profiles, and what moves them."""
