:- use_module(library('shelf')).
