from ._single import RecordMotion as RecordMotion
