set terminal svg size 1380,380 dynamic background rgb 'white' font 'Helvetica,13'
datafile = 'policies-runs.dat'
set grid lc rgb '#dddddd'
set border lc rgb '#555555'
set multiplot layout 1,3
set key below center horizontal noenhanced samplen 1.5
set title noenhanced
set autoscale fix
set lmargin 9
set bmargin 6
set xlabel noenhanced
set ylabel noenhanced
set offsets graph 0.03, graph 0.03, graph 0.05, graph 0.05
set title 'Motion of the first 40 runs'
set xlabel 'theta'
set ylabel 'vtheta'
plot datafile index 1 using 1:2 with lines lw 1 lc rgb '#7fa9d8' title '18 succeeded', datafile index 0 using 1:2 with lines lw 1 lc rgb '#d1641f' title '22 failed', '+' using (0):(0) every ::0::0 with points pt 7 ps 0.9 lc rgb '#000000' title 'goal'
set title 'Starts of 500 runs'
set xlabel 'theta'
set ylabel 'vtheta'
plot datafile index 3 using 1:2 with points pt 7 ps 0.4 lc rgb '#1f5fa8' title '221 succeeded', datafile index 2 using 1:2 with points pt 2 ps 0.8 lc rgb '#d1641f' title '279 failed'
set title 'Inputs of the first 8 runs: u'
set xlabel 't (s)'
set ylabel 'u'
plot datafile index 5 using 1:2 with steps lw 1.2 lc rgb '#7fa9d8' title '5 succeeded', datafile index 4 using 1:2 with steps lw 1.2 lc rgb '#d1641f' title '3 failed', -10 with lines lw 1.5 dt 2 lc rgb '#555555' title '', 10 with lines lw 1.5 dt 2 lc rgb '#555555' title 'limits'
unset multiplot
