"""Plan of a render: the stages that run, with reasons."""
