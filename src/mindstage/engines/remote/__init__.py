"""Remote: an engine at the other end of a rosbridge."""

__all__: list[str] = []
