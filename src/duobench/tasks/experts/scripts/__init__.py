"""The script of each task's expert, one task a file; and what a script wins with closed eyes."""
