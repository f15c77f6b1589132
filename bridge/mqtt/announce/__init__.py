"""Announcements to Home Assistant."""
