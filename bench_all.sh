for a in "tools beam3d_any 3" "grips beam3d_any 4" "tools liver3d 2" "grips liver3d 2"; do timeout 170 .venv-surrogate/bin/python bench_frames.py $a; done
