"""Prediction: what a fitted limb feels under another tool, motion or at another spot."""

from palpate_prediction.files import write_prediction as write_prediction
from palpate_prediction.predict import Prediction as Prediction, run_prediction as run_prediction
