"""`terrain`: an aircraft above ridges that look alike."""
