"""Descriptions: what a person writes, frozen and validated. One module per thing described."""
