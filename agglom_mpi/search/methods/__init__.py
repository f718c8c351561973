"""Search methods: how strings are proposed, one class each."""
