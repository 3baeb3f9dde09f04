"""Material cards: a fitted material in the convention of another program, with its formula and range."""

from palpate_prediction.cards.card import CardData as CardData
from palpate_prediction.cards.of_run import cards_of as cards_of
from palpate_prediction.cards.programs import PROGRAMS as PROGRAMS, joined as joined
