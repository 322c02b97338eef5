"""Proposals of scenes: what two mesh files tell about a joint, tried out and written down."""
