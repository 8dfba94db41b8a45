"""Laws that are in no list: hidden in rigs, and a diagnosis is judged by what it makes of them."""
