"""The stepper motor controller of the manuals: registers, coils, motion and programs."""
