# The links of spherical pendulums, each on a unit sphere. T[1]: title, T[2]: number of links, T[3]: number of true curves of all links, T[4]: of predicted
# ones. The first blocks are the true curves, each link's in turn; the predicted ones follow. Columns: x y z.
links = V(2)
true = V(3)
all = V(3) + V(4)
wide = links > 1 ? 520 : 700
columns = links < 3 ? links : 3
rows = int(links + 2) / 3
eval size(wide*columns, wide*rows + 30)
set multiplot layout rows, columns title T[1] noenhanced
set view equal xyz
set view 65,35,links > 1 ? 1.1 : 1.15
set key top left
set xyplane at -1
eval unit
set border 31
set xtics -1,1,1 offset 0,-0.3
set ytics -1,1,1 offset 0,-0.3
set ztics -1,1,1
set xlabel 'q_x' offset 0,-0.5
set ylabel 'q_y' offset 0,-0.5
set label 'q_z' at -1,-1,1.15 center
set arrow from 1,1,0.4 to 1,1,-0.4 lw 2.5 lc rgb '#333333' head filled front
set label 'gravity' at 1,1,0.55 center front
do for [link = 1:links] {
    if (links > 1) { set title sprintf('link %d', link) }
    if (true > 0) {
        splot @sphere with lines lc rgb '#dcdcdc' lw 0.5 notitle, \
            for [k = link:true:links] datafile index k using 1:2:3 with lines lw 2 lc rgb '#1f5fa8' title k == link ? 'true' : '', \
            for [k = true+link:all:links] datafile index k using 1:2:3 with points pt 7 ps 0.5 lc rgb '#d1641f' \
            title k == true+link ? 'predicted' : ''
    } else {
        splot @sphere with lines lc rgb '#dcdcdc' lw 0.5 notitle, \
            for [k = link:all:links] datafile index k using 1:2:3 with lines lw 1.5 lc rgb '#d1641f' title k == link ? 'predicted' : ''
    }
}
