:- module(shelf, [shelves/2]).
shelves(cupboard, 3).
