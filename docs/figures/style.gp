# SPDX-License-Identifier: GPL-3.0-or-later
# What all figures share. Colours of Okabe & Ito (2008), safe for the colour-blind.
blue = '#0072B2'; orange = '#D55E00'; green = '#009E73'; pink = '#CC79A7'; yellow = '#E69F00'; sky = '#56B4E9'
grey = '#777777'; black = '#000000'
page(name, width, height) = sprintf("set terminal pngcairo size %d,%d font 'DejaVu Sans,15' enhanced; set output '%s/%s.png'", \
  width, height, figures, name)
# Panel from left to right and bottom to top, in fractions of the page.
panel(x0, x1, y0, y1) = sprintf("set lmargin at screen %g; set rmargin at screen %g; set bmargin at screen %g; set tmargin at screen %g", x0, x1, y0, y1)
set border 3 lw 1.2 lc rgb '#333333'
set tics nomirror tc rgb '#333333'
set grid lw 0.6 lc rgb '#dddddd'
set bars 0
set pointsize 1.2
