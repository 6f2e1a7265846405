# SPDX-License-Identifier: GPL-3.0-or-later
# How far Taylor's bar is from its limit against CPU time, one choice at a time and by the size, from bench_otm chart.
load figures.'/style.gp'
eval page('taylor_choices', 1300, 820)
found = data.'/taylor_choices.csv'
set datafile separator ','
stats found skip 1 using (strcol(1) eq 'limit' ? $6 : 1/0) name 'length' nooutput
stats found skip 1 using (strcol(1) eq 'limit' ? $7 : 1/0) name 'foot' nooutput
array choices[3] = ['gamma', 'cutoff', 'reconnection_strain']
array titles[3] = ['{/Symbol g}', 'cutoff', 'reconnection_strain']
array values[3] = ['1 1.8 2.5 3 4', '0.01 0.0001 1e-06', '0.02 0.05 0.1 0.2 0.4']
array defaults[3] = ['2.5', '0.0001', '0.2']
array names[2] = ['length', 'foot']
array low[2] = [0.05, 0.4]
array high[2] = [1, 15]
off(row) = 100 * abs((row == 1 ? $6 / length_mean : $7 / foot_mean) - 1)
colour(k, i) = word(values[k], i) eq defaults[k] ? blue : word(colours, i)
colours = orange.' '.green.' '.pink.' '.yellow.' '.sky
set multiplot
set logscale xy
set format y '%g'; set xrange [0.1:30]; set xtics (0.1, 0.3, 1, 3, 10, 30)
do for [row = 1:2] {
  do for [k = 1:3] {
    eval panel(0.07 + 0.315 * (k - 1), 0.345 + 0.315 * (k - 1), row == 1 ? 0.55 : 0.08, row == 1 ? 0.93 : 0.46)
    set title titles[k] offset 0,-0.4
    set yrange [low[row]:high[row]]
    set xlabel row == 2 ? 'CPU seconds' : '' offset 0,0.4
    set ylabel k == 1 ? names[row].' off its limit, %' : '' offset 1,0
    if (row == 1) { set key at graph 0.02,0.02 bottom left Left reverse samplen 1.6 font ",12" } else { unset key }
    plot for [i = 1:words(values[k])] found skip 1 \
      using (strcol(1) eq choices[k] && strcol(2) eq word(values[k], i) ? $9 : 1/0):(off(row)) \
      with linespoints pt 7 lw (word(values[k], i) eq defaults[k] ? 3.5 : 1.8) \
      lc rgb colour(k, i) title word(values[k], i)
  }
}
unset multiplot
