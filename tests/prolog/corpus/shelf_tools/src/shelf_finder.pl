:- interface(shelf_finder, [ free_shelf/1 ]).
