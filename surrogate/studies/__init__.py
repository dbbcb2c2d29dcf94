"""The paper's tables and figures, one file a study, done on datasets that `datagen` makes."""
