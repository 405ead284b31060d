"""Where a recording and its model differ, which physics was left out, and the model with it."""
