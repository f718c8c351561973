"""One setting of a scene varied at a time: steps, samples, box, end time; extreme scenes."""
