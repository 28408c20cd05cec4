:- module(shelf_model, [ implements('./shelf_finder.pl') ]).
free_shelf(top).
