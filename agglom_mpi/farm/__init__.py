"""Who simulates what, when: scheduler, messages, master and workers."""
