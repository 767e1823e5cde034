"""The devices of a cell together: opened, checked, owned, dark or lit."""
