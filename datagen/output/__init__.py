"""Output from datasets for people: figures, time series for ParaView, summaries."""
