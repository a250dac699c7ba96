# Energies of equilibria against x. T[1]: number of pieces of equal stability of the branches. Then for each piece its branch (from 0),
# and 1 if it is of saddles, else 0. Columns: x, energy. Index k: piece k.
set xlabel 'x / π'
set ylabel 'energy'
set xrange [0:2]
set xtics 0.25
set key outside top center horizontal
colour(b) = word('#1f5fa8 #d1641f #2e8b57 #8b3a8b #b8860b #c0392b #17a2b8 #6b4423 #5d6d7e #7cb342 #e377c2 #3f51b5', 1 + int(b) % 12)
saddle(k) = V(2 * k + 1) > 0
saddles = sum [k = 1:int(V(1))] saddle(k)
plot 1/0 with lines lw 2 lc rgb '#444444' title 'minima', \
    1/0 with lines lw 1.3 dt 2 lc rgb '#444444' title (saddles > 0 ? 'saddles' : ''), \
    for [k = 1:V(1)] datafile index k using ($1 / pi):2 \
        with linespoints ps 0.4 pt (saddle(k) ? 6 : 7) lw (saddle(k) ? 1.3 : 2) dt 1 + saddle(k) lc rgb colour(V(2 * k)) notitle
