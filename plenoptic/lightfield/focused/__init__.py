"""Pictures from the raw images of focused cameras."""
