# The drift of the energy along a prediction. Columns of index 1: t, |H - H(0)| of the learned energy, and of the true one.
set title 'Energy along the prediction, from its value at the start'
set logscale y
set format y '10^{%L}'
set xlabel 't / (L/g)^{1/2}'
set ylabel '|H - H(0)| / (m g L)'
set key below center horizontal
plot datafile index 1 using 1:3 with lines lw 1.5 lc rgb '#1f5fa8' title 'true energy of the prediction', \
    datafile index 1 using 1:2 with lines lw 1.5 lc rgb '#d1641f' title 'learned energy'
