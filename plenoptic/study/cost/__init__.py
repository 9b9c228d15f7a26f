"""What each part of a render costs."""
