# Curves on the unit sphere. T[1]: title; then for each curve its symbol, 1 if it is a matrix times a vector, else 0, and this vector. Block k is
# curve k: a vector of any length, or the rows of the matrix.
n = (count - 1) / 5
eval size(900, 760)
symbol(k) = T[5*k - 3]
turned(k, c) = V(5*k - 2) == 0 ? column(c) : sum [i = 1:3] column(3*c - 3 + i)*V(5*k - 2 + i)
part(k, c) = turned(k, c) / sqrt(turned(k, 1)**2 + turned(k, 2)**2 + turned(k, 3)**2)
set tics nomirror
set title T[1]
set view 68,30,1.15
set view equal xyz
set xyplane relative 0
eval unit
set xtics -1,1,1
set ytics -1,1,1
set ztics -1,1,1
set xlabel 'x'
set ylabel 'y'
set zlabel 'z'
set border 31 lc rgb '#bbbbbb'
set tics textcolor rgb '#555555'
set key at screen 0.98,0.93 right top vertical samplen 2 nobox
splot @sphere with lines lc rgb '#e2e2e2' lw 0.5 notitle, \
    for [k = 1:n] datafile index k using (part(k, 1)):(part(k, 2)):(part(k, 3)) with lines lw 1.6 lc rgb colour(k) title symbol(k), \
    for [k = 1:n] datafile index k every ::0::0 using (part(k, 1)):(part(k, 2)):(part(k, 3)) with points pt 7 ps 0.9 lc rgb colour(k) title n > 1 ? '' : 'start'
