"""What a render will take, from a few of its pixels."""
