"""Files that appear under their name whole or not at all."""

import os
from pathlib import Path
import tempfile

from checkweigher_driver.bag_file import output_error


def write_whole(path: Path, text: str) -> None:
    """Write a text file in UTF-8, in place of one that is there.

    Parameters
    ----------
    path : Path
        Its folder must exist.
    text : str
        Line ends stay as they are.

    Raises
    ------
    OutputError
        If it cannot be written; what was there before then stays.
    """
    try:
        number, name = tempfile.mkstemp(prefix=f'.{path.name}-', dir=path.parent)
        try:
            with open(number, 'w', encoding='utf-8', newline='') as file:
                file.write(text)
            os.chmod(name, 0o644)
            os.replace(name, path)
        except BaseException:
            os.unlink(name)
            raise
    except OSError as error:
        raise output_error(path, error) from None
