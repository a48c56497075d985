"""Answers by closed forms and refined solutions: decay, modes, delays, oscillation, waves."""
