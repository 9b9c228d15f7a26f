"""What a call shows that takes long: how far it is, and what is compiled first."""
