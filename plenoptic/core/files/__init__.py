"""Files shared by all rooms: images, values as text, atomic replacement of files."""
