"""Material cards: a fitted material in the convention of another program, with its formula and range."""

from palpate.cards.card import CardData as CardData
from palpate.cards.of_run import cards_of as cards_of
from palpate.cards.programs import PROGRAMS as PROGRAMS, joined as joined
