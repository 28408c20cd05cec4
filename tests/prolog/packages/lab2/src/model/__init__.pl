% A file in the manner of KnowRob's packages.
:- use_module('./lab_objects.pl').
