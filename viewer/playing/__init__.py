"""From a source to the moment that is shown: play, pause, step, seek."""
