"""The Debian package: built, put into a repository, and tried on machines with a real systemd."""
