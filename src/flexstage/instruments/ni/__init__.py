"""NI cards: sensors at analogue inputs, drives behind amplifiers at analogue outputs."""
