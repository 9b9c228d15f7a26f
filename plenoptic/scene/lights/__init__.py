"""What lights a scene: one file a light."""
