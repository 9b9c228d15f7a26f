"""What the camera looks at: meshes, materials, textures, lights and backgrounds, and the tables made of them."""
