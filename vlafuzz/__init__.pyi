from vlafuzz.api import (
    bisect as bisect,
    demonstrate as demonstrate,
    diff as diff,
    film as film,
    fuzz as fuzz,
    open_store as open_store,
    regress as regress,
)

__version__: str
