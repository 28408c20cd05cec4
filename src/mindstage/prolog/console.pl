% What Python calls: everything in module `user` that there is to ask, and goals that end.

:- module(mindstage_console, [start/1, solve/4, solve_line/4, consult_file/2, on_interrupt/2]).
:- use_module(asking).
:- use_module(lines).
:- use_module(names).
:- use_module(semweb, []).
:- use_module(thesis, []).
:- use_module(library(apply)).
:- use_module(library(error)).
:- use_module(library(lists)).
:- use_module(library(solution_sequences)).
:- use_module(library(time)).

% start(-Alarm): anew for each console; nudge where a signal wakes Prolog without ending the process.
start(Alarm) :-
    on_signal(usr2, Handler, Handler),
    (   Handler == default -> Alarm = none ; Alarm = nudge ),
    facade,
    request(prefixes, Pairs),
    keep_prefixes(Pairs),
    define_questions.

facade :- module_property(mindstage, exports(_)), import_module(user, mindstage), !.
facade :-
    forall(( member(Module, [mindstage_thesis, mindstage_semweb]), module_property(Module, exports(Names)) ),
           forall(member(Name, Names), mindstage:import(Module:Name))),
    forall(member(Name, [questions/0, why/1, missing/2]), mindstage:import(mindstage_asking:Name)),
    delete_import_module(mindstage, user),
    add_import_module(mindstage, system, start),
    add_import_module(user, mindstage, start).

% -- goals -------------------------------------------------------------------------------------------------------------

% solve(+Text, +Limit, +Seconds, -End): found(Rows), refused(Kind, Sentence), timed_out or interrupted.
solve(Text, Limit, Seconds, End) :-
    catch(solutions(Text, Limit, Seconds, End), Error, ended(Error, End)),
    flush_output(user_output).

solutions(Text, Limit, Seconds, found(Rows)) :-
    term_string(Goal, Text, [variable_names(Variables), module(user)]),
    (   Goal == end_of_file -> syntax_error(end_of_file) ; true ),
    call_with_time_limit(Seconds, findall(Variables, limit(Limit, user:Goal), Solutions)),
    maplist(row, Solutions, Rows).

% solve_line(+Text, +Limit, +Seconds, -End): the same for what a stranger asks, in little memory.
solve_line(Text, Limit, Seconds, End) :-
    current_prolog_flag(stack_limit, Before),
    most_memory(Bytes),
    Least is min(Before, Bytes),
    setup_call_cleanup(
        set_prolog_flag(stack_limit, Least),
        catch(line(Text, Limit, Seconds, End), Error, ended(Error, End)),
        set_prolog_flag(stack_limit, Before)).

most_memory(33554432).

line(Text, Limit, Seconds, found(Rows)) :-
    line_goal(Text, Variables, Goal),
    call_with_time_limit(Seconds, findall(Variables, ( limit(Limit, bounded(Goal)), acyclic_term(Variables) ), Solutions)),
    maplist(row, Solutions, Rows).

row(Variables, Row) :-
    findall([Name, Cell], ( member(Name=Value, Variables), \+ sub_atom(Name, 0, _, _, '_'), cell(Value, Cell) ), Row).

% Terms that other programs have no form for are shown as people read them.
cell(Value, Value) :- \+ compound(Value), !.
cell(Value, Cells) :- is_list(Value), !, maplist(cell, Value, Cells).
cell(Value, Cell) :- format(atom(Cell), "~p", [Value]).

ended(time_limit_exceeded, timed_out) :- !.
ended(mindstage_interrupted, interrupted) :- !.
ended('$aborted', interrupted) :- !.
ended(unwind(abort), interrupted) :- !.
% Its context has no message: it is as large as what there was no place for.
ended(error(resource_error(What), _), refused(prolog, Sentence)) :- !,
    format(string(Sentence), "it takes more memory (~w) than it may have", [What]).
ended(Error, refused(Kind, Sentence)) :-
    (   Error = mindstage_error(Kind, _) -> true ; Kind = prolog ),
    sentence(Error, Sentence).

% What Prolog would print of an error, in one line. Where it was thrown from is our own doing, but for a syntax error.
sentence(error(Formal, Context), Sentence) :- Formal \= syntax_error(_), nonvar(Context), !,
    sentence(error(Formal, _), Sentence).
sentence(Error, Sentence) :-
    '$messages':translate_message(Error, Lines, []),
    with_output_to(string(Text), print_message_lines(current_output, '', Lines)),
    split_string(Text, "\n", " \t", Parts),
    exclude(==(""), Parts, Told),
    atomic_list_concat(Told, ' ', Atom),
    atom_string(Atom, Sentence).

% consult_file(+File, -Errors): how many there were, or interrupted.
consult_file(File, Errors) :-
    statistics(errors, Before),
    catch(user:load_files(File, []), Error, stopped(Error, Stopped)),
    statistics(errors, After),
    (   nonvar(Stopped) -> Errors = Stopped ; Errors is After - Before ).

stopped(mindstage_interrupted, interrupted) :- !.
stopped(Error, _) :- print_message(error, Error).

% on_interrupt(+Action, -Done): what Ctrl-C does: debug, throw or default.
on_interrupt(throw, true) :- !, on_signal(int, _, mindstage_console:interrupted).
on_interrupt(Action, true) :- on_signal(int, _, Action).

interrupted(_) :- throw(mindstage_interrupted).

% -- the end -----------------------------------------------------------------------------------------------------------

% The last of all that is done at halt, which ends the process: see _halting in console.py.
ending :-
    forall(( clause(system:'$at_halt'(Goal, _), true), Goal \= _:ending ), catch(ignore(Goal), _, true)),
    flush_output(user_output),
    flush_output(user_error),
    (   current_prolog_flag(exit_status, Status) -> true ; Status = 0 ),
    request(halting(Status), _).

:- initialization(at_halt(mindstage_console:ending)).

% -- messages ----------------------------------------------------------------------------------------------------------

:- multifile prolog:message//1.

prolog:message(mindstage_error(Kind, Sentence)) --> [ '~w'-[Sentence] ], mindstage_console:hint(Kind).
prolog:message(mindstage_interrupted) --> [ 'interrupted' ].
prolog:message(mindstage_unknown(Sentence)) --> [ '~w'-[Sentence] ].
prolog:message(mindstage_failed(Number)) -->
    [ '~D items could not be spawned; debug_failed_items lists them'-[Number] ].
prolog:message(mindstage_dark(Name, Why)) --> [ '~w stays dark: ~w'-[Name, Why] ].

hint(body_unknown) --> !, [ '; spawn_semantic_map(Map) puts what a map describes into the world' ].
hint(_) --> [].
