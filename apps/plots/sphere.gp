# Curves on the unit sphere. T[1]: title, then the symbol of each curve. Block k is curve k: x y z, of any length.
n = count - 1
eval size(900, 760)
length(x, y, z) = sqrt(x**2 + y**2 + z**2)
part(k) = column(k) / length($1, $2, $3)
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
    for [k = 1:n] datafile index k using (part(1)):(part(2)):(part(3)) with lines lw 1.6 lc rgb colour(k) title T[1 + k], \
    for [k = 1:n] datafile index k every ::0::0 using (part(1)):(part(2)):(part(3)) with points pt 7 ps 0.9 lc rgb colour(k) title n > 1 ? '' : 'start'
