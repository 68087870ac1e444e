"""The package as a whole."""

import redundancy as rd


def test_every_public_name_exists_once():
    assert len(rd.__all__) == len(set(rd.__all__))
    assert all(hasattr(rd, name) for name in rd.__all__)


def test_exceptions_are_value_errors():
    for error in (rd.DescriptionError, rd.NotSrsError, rd.FileFormatError):
        assert issubclass(error, rd.RedundancyError)
    assert issubclass(rd.RedundancyError, ValueError)
