"""What leaves a dataset for people: figures, series for ParaView, summaries."""
