"""Many people: one reconstruction per folder."""
