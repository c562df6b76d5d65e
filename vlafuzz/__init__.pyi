from vlafuzz.api import bisect as bisect
from vlafuzz.api import demonstrate as demonstrate
from vlafuzz.api import diff as diff
from vlafuzz.api import film as film
from vlafuzz.api import fuzz as fuzz
from vlafuzz.api import open_store as open_store
from vlafuzz.api import regress as regress

__version__: str
